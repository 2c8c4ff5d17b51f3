"""What the bigger commands do, without their command line."""
