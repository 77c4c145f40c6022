"""Command line `truerate`: one module for each group of verbs; each verb returns an exit code.

Start reading at `main`, which loads only the module of the given verb.
"""
