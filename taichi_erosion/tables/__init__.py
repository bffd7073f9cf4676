"""Tables as people write them: cells of text files and workbooks, and the words of their headings."""
