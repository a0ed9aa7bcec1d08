from discsim.cli import main

main()
