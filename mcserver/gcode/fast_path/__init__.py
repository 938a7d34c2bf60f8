"""Interpret lines of G00 to G03 in columns, bit for bit as the block interpreter does line by line (of tools
but for the last bits).

`vocabulary` is made from the tables of the block interpreter, and has the words that lines in columns may
have. A line with another word, or with a possible fault, goes to the block interpreter. Property tests
compare values, state and faults.
"""
