"""Motion of one skeleton on another: bones matched, rest poses aligned, feet kept on the ground."""
