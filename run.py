import json,sys,time
sys.path.insert(0,'.')
from pathlib import Path
from taichi_erosion.experiments.audit import audit, as_document
t0=time.time()
pat=sys.argv[1] if len(sys.argv)>1 else ''
for nm,pl in json.load(open('/tmp/w/trials/list.json')):
    if pat not in nm: continue
    try: a=audit(Path(f'/tmp/w/trials/t/{nm}.csv')); d=as_document(a)
    except Exception as e: print(f'{nm:32} planted={pl} EXC {type(e).__name__} {e}'); continue
    print(f"{nm:32} planted={pl} n={d['runs']} f={len(d['factors'])} y={d['response']} bal={d['balanced']} orth={d['orthogonal']} {d['printed_numbers']['agree']}/{d['printed_numbers']['compared']} :: {d['assumed']}")
    for f in d['findings']: print('      ',f['kind'],'|',f['sentence'][:170])
print(time.time()-t0)
