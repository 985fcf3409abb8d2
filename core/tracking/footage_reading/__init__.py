"""Reading footage for the tracker: decoded, stored, and what it shows of performers and of cameras that turn."""
