"""Companion code of the course, one package a chapter."""
