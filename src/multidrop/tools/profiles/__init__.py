"""What is known of a device model: found out, named, written as text and as tables."""
