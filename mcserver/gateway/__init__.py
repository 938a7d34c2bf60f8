"""WebSocket and HTTP for clients without Zenoh: browsers, and languages whose Zenoh is not at hand."""
