"""Workers, their leases and what came of them."""
