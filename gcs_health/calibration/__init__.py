"""What a healthy flight teaches: control effectiveness, noise, time shift, and whether the geometry holds."""
