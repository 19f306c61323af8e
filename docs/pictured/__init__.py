"""Pictures of capabilities whose runs draw no figure of their own: each from a run of the library, made here."""
