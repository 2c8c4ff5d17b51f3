"""Why a device tripped: freeze-frames."""
