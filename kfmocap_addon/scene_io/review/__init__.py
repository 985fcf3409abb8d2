"""What a tracking reports about its result, kept on bones and in lists."""
