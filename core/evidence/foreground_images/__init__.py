"""How likely each pixel shows a performer: by colours, against the background, cast shadows and strangers."""
