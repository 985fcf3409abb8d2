"""What is tracked: views, footage, performers, key poses, settings."""
