"""The gateway over HTTP: a page for people, JSON for programs, live values, metrics."""
