"""States to a broker, commands from it."""
