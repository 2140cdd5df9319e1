"""Pure bytes: messages, the belief coding, the codec, the topic table and envelopes. docs/wire.md describes them all."""
