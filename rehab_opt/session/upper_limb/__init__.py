"""System `upper_limb`: a person's arm follows a recorded hand path within the person's joint limits."""
