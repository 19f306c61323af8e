"""Which robot a problem is run on: the table `[plant]`, the option `--plant`, and what they stand for."""
