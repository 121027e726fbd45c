"""One assessment: build the system, move it, record it, judge it, estimate K_h."""
