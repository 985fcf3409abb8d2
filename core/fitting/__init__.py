"""Bodies and cameras fitted to key poses."""
