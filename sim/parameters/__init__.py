"""What an assessment takes: factors, conditions, a wearer, a fidelity."""
