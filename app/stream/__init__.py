"""Time and transport: clock, encoder, broadcast, muxers, WebRTC, sessions."""
