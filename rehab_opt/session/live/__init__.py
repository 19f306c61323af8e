"""Problems that run in real time before somebody's eyes: what a kind of problem says of itself for that."""
