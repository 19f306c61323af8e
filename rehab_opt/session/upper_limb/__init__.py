"""A recorded hand path followed within a person's joint limits."""
