"""What was: samples, stores, buckets for charts."""
