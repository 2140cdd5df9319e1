"""Pure bytes: messages, the belief coding, the codec, the topic table and envelopes. See docs/wire.md and docs/bytes.md."""
