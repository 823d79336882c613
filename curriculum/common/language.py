"""What a tape does as lines of a language: what is used once stands where it is used."""

from collections import Counter

WIDTH = 80  # characters of what is used once and has no line of its own, at most
# How tightly an operator binds; a choice, a product, a sign; names, numbers and calls.
BINDS = {"<": 1, "<=": 1, "+": 2, "-": 2, "*": 3, "/": 3}
CHOICE, PRODUCT, MINUS, ATOM = 0, 3, 4, 5


class Language:
    """A subclass has the words: `number`, how a float is written; `functions` {sign: name}.

    `assigned`: a line that gives a name to an expression. `minus`: how tightly what follows a sign
    has to bind. `calls` and `loop`, (part, signed) -> lines; signed(symbol) is its expression.
    """

    def write(self, tape, *groups):
        """For each group of symbols, lines of what no group before computes, and expressions."""
        everything = tape.needed(sum(groups, []))
        used = Counter(s.x for group in groups for s in group)
        used.update(x for name in everything for x in tape.nodes[name][1:])
        for name in tape.parts.keys() & set(everything):
            used.update(tape.nodes[name][1:])  # twice: what a part needs is to have a name
        texts, done = {}, set()

        def text(x, binds=0):
            expression, bound = texts.get(x) or (x if isinstance(x, str) else self.number(x), ATOM)
            return f"({expression})" if bound < binds else expression

        def signed(s):
            return f"-{text(s.x, self.minus)}" if s.minus else text(s.x)

        for group in groups:
            lines = []
            for name in everything if group is groups[-1] else tape.needed(group):
                if name in done:
                    continue
                done.add(name)
                sign, *operands = tape.nodes[name]
                if name in tape.parts:
                    lines += getattr(self, sign)(tape.parts[name], signed)
                elif sign != "of":
                    expression, bound = self.operation(sign, operands, text)
                    if used[name] == 1 and len(expression) < WIDTH:
                        texts[name] = expression, bound
                    else:
                        lines.append(self.assigned.format(name, expression))
            yield lines, list(map(signed, group))

    def operation(self, sign, operands, text):
        """What an operation is written as, and how tightly that binds."""
        if sign not in BINDS:
            return f"{self.functions[sign]}({', '.join(map(text, operands))})", ATOM
        bound = BINDS[sign]
        left, right = operands
        left = text(left, max(bound, 2))  # in Python a < b < c is something else
        return f"{left} {sign} {text(right, bound + 1)}", bound
