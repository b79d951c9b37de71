"""A mapping proposed for a table of unknown origin: what each column may be, why, and how sure that is.

raw       columns of a file as they stand: text of any dialect, spreadsheets, Parquet, MATLAB
words     names and units, in English, German and common abbreviations
meant     what a column is taken for, and how sure that is
columns   what each column is: by its name and unit, and by what its numbers do
rates     columns that are the rates of others
assign    which column is which channel of which system
proposal  the mapping file, with a reason behind every line
"""
