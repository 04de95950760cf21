"""All Warp code. May import `checking` and below."""

import warp as wp

if wp.config.log_level == wp.LOG_INFO:  # as it is where no one asked for more
    wp.config.log_level = wp.LOG_WARNING  # not a line for each kernel
