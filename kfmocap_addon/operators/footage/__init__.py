"""Tools that bring footage, shots and other files into the scene, and show them."""
