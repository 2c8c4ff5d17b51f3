"""Many transactions on a wire where everything goes wrong: `make soak` runs them all."""
