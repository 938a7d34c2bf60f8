"""Lines of G00 to G03 in columns, equal bit for bit to the block interpreter, which knows the whole dialect.

What a word means in columns is in `vocabulary`, made from the same tables that the block interpreter reads; a
line with a word that is not there, and whatever may be a fault, is read line by line. Property tests compare
values, state and faults.
"""
