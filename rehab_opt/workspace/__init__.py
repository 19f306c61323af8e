"""Where a limb reaches, and maps between such sets."""
