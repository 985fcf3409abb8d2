"""Camera objects with their footage, as the core takes them, and back."""
