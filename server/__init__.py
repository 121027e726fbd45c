"""The coordinator: routes -> logic -> store.

Takes studies, leases their instances to workers, keeps what they report. Never imports MuJoCo.
"""
