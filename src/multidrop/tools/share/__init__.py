"""One port for many masters."""
