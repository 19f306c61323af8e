"""Controllers that command only what can still be braked without breaking a limit."""
