"""A mapping proposed for a table of unknown origin: what each column may be, why, and how sure that is.

raw       columns of a file as they stand: text of any dialect, spreadsheets, Parquet, MATLAB
words     names and units, in English, German and common abbreviations
columns   what a column is: by its name and unit, and by what its numbers do
assign    which column is which channel of which system
proposal  the mapping file, with a reason behind every line
"""
