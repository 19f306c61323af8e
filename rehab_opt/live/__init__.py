"""A local page in which a problem runs in real time: who may look, who commands, and what is drawn."""
