"""How a problem is stated, solved and certified; nothing here knows of robots."""
