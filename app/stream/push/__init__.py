"""A stream pushed to other servers, by RTMP and WHIP, from processes of their own."""
