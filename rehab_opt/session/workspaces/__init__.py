"""Where an arm reaches, and maps between such sets."""
