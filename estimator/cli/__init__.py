"""The command `truerate`: one module per group of verbs, arguments in, exit code out.

Start reading at `main`, which loads only the module of the given verb.
"""
