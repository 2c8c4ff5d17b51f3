"""What is on a line: which protocol, which settings, which addresses."""
