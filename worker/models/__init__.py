"""Which models this worker offers (`models.running` evaluates them), and their canaries.

The worker's owner names what is code: folders (`--models`), packages (`--allow`), servers
(`--umbridge`).
"""
