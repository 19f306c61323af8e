"""`python -m rehab_opt` is the command `rehab-opt`."""

from rehab_opt.cli import main

if __name__ == "__main__":
    main()
