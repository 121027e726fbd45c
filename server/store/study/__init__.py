"""Studies, their instances, and what is known of them."""
