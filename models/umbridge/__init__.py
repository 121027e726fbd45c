"""UM-Bridge, a protocol between models and whoever samples them (Seelinger et al. 2023).

Version 1.0: JSON over HTTP; a model maps vectors to vectors. Ours take one vector of all factors.
"""
