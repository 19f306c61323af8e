"""`python -m rehab_opt` runs the command `rehab-opt`."""

from rehab_opt.cli import main

if __name__ == "__main__":
    main()
