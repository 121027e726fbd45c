"""What is said of one session: the contract's answer, its page and its pictures."""
