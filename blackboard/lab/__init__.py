"""The laboratory: rules judged on the same opinions, parameters chosen from runs, the paper's figures."""
