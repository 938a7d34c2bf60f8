"""OPC UA: machines as machine tools of OPC 40501-1, read-only."""
