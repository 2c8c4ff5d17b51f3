"""The world of multidrop: real lines, real processes, real terminals."""
