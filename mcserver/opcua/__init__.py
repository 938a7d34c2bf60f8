"""OPC UA: machines as machine tools of OPC 40501-1, which take orders where their files say so."""
