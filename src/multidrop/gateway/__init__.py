"""The plant gateway: lines that are polled, and what the rest of the world gets of them."""
