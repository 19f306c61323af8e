"""QPs and NLPs recorded from this library's controllers, and solvers compared on them."""
