"""`python -m multidrop` is the `multidrop` command."""

from multidrop.cli import main

main()
