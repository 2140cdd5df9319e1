"""The shut door: who belongs to a team, what each may write and read, and the certificates and settings that hold it to that."""
