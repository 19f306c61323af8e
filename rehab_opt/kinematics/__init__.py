"""What moves: serial chains from Denavit-Hartenberg rows, the human arm, the UR5."""
