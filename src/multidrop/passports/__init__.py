"""What a device holds, as a file: made, compared, restored."""
