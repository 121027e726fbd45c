"""How the exoskeleton holds the arm: cuffs and straps in contact, or bushings."""
