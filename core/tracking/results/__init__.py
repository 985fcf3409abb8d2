"""What tracking returns, put together from finished segments, which are kept in a journal."""
