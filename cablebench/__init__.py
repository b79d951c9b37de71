"""Protocol, metrics, statistics, evaluation and boards for the environments of `cable_envs`.

How a command line calls it (nothing here imports torch; rich, jinja2 and matplotlib are imported where they are used)::

    protocol = load_protocol("quick")                                       # cablebench.protocol
    store = ResultStore("results/quick.jsonl")                              # cablebench.store
    entrants = reference_entrants() + (agent_entrant("ppo", policy, ...),)  # cablebench.evaluate
    evaluate(protocol, entrants, tasks=(), tracks=(), store=store, progress=lambda p: print(p.done, p.total, p.text))
    board = build_board(protocol, store.records())                          # cablebench.board
    print_board(board, rich_console)                                        # cablebench.report
    paths = write_board(board, "results/quick", trajectories=store.trajectories)   # board.json, board.md, board.html

    episode = run_episode(env, actor, seed)            # one episode (cablebench.evaluate), as `Episode` arrays
    values = measure(episode)                          # {metric name: SI value} (cablebench.metrics)
"""
