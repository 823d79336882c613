"""The answers: what stands in place of the blanks. Exercises run with them when told --solved.

What a function takes and returns is said in its exercise.
"""
