"""What every request passes: connections, compression, who may speak, and how refusals look."""
