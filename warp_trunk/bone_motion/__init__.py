"""Where the bones are between before and after surgery: plans, rigid bones and ribs, and their path.

May import `measures`, `views` and below.
"""
