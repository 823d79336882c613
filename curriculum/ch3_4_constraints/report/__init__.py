"""What a run leaves: the table, the answer to --within, the files and the recording."""

from curriculum.ch3_4_constraints.report.answer import find_answer, print_answer
from curriculum.ch3_4_constraints.report.files import write_files
from curriculum.ch3_4_constraints.report.request import request
from curriculum.ch3_4_constraints.report.table import (
    completed,
    energy,
    force,
    print_table,
)
from curriculum.common.words import length

__all__ = [
    "completed",
    "energy",
    "find_answer",
    "force",
    "length",
    "print_answer",
    "print_table",
    "request",
    "write_files",
]
