"""The coordinator: routes -> operations -> logic and store, which do not know each other.

Takes studies, leases their instances to workers, keeps what they report. Never imports MuJoCo.
"""
