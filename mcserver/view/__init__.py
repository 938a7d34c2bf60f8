"""A machine's parts as solids, and where its joints bring them: what pages, exports and Foxglove draw."""
