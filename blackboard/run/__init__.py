"""Running processes: what all doors share, the launcher and its supervisor, health checks."""
