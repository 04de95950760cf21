"""A trunk seen from one side, and the colours of its hump. May import `spine` and below."""
