"""From records to a ranked board: scores, statistics, tables, figures, pages."""

from cablebench.board.board import build_board
from cablebench.board.report import print_board, render_json, render_markdown, write_board
from cablebench.board.tables import Board, Row, Table

__all__ = ["Board", "Row", "Table", "build_board", "print_board", "render_json", "render_markdown", "write_board"]
