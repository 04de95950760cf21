"""Where the bones are between before and after surgery."""
