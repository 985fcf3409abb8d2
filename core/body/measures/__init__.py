"""How large a body and its parts are: measures taken, changed, and fitted to landmarks."""
