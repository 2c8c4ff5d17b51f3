"""The world: ports, lines, clocks, files. Everything below is pure."""
