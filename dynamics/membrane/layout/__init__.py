"""How nodes and elements lie in memory, and how threads share them. Knows no physics."""
