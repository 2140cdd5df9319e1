"""For people: what is shown of the state of a team (why, status, frames of the live page)."""
