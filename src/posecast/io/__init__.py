"""Readers and writers, one format a file: metres, y up, wxyz behind this door."""
