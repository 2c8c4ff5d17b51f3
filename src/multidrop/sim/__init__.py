"""Simulated devices on simulated lines: the other side of every conversation, without hardware."""
