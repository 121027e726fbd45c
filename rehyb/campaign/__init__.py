"""The paper's two-phase study as one run."""
