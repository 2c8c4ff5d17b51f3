"""Why a line fails, with the bytes that prove it."""
