"""For people: one pure fold from envelopes to the state of a team, and what is shown of it (why, status, frames of the live page)."""
