"""Pure bytes: messages, the belief coding, the codec, THE topic table and envelopes. docs/wire.md tells it to other languages."""
