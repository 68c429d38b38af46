import sys,json,os
from gen import *; from machines import M; from cases import C
def app(d,ch):
    d=dict(d)
    for k,(o,v) in ch.items(): d[k]=v if o=='=' else d[k]+v if o=='+' else d[k]*v
    return d
if __name__=='__main__':
    truth=[]
    for i,c in enumerate(C):
        P,cam,me=M[c['machine']]
        truth.append(dict(case=c['case'],machine=c['machine'],kind='base' if 'base' in c['case'] else 'null' if not c['truth'] else 'double' if len(c['truth'])>1 else 'single',speed=c['speed'],push=c['push'],P_changes={k:[P[k],app(P,c['P'])[k]] for k in c['P']},cam_changes={k:[cam[k],app(cam,c['cam'])[k]] for k in c['cam']},truth=c['truth'],seeds=[1000+10*i,1001+10*i],machine_parameters=P if 'base' in c['case'] else None,camera=cam if 'base' in c['case'] else None))
    json.dump(truth,open('truth.json','w'),indent=1)
    only=sys.argv[1:]
    os.makedirs('rec',exist_ok=True)
    for i,c in enumerate(C):
        if only and c['case'] not in only: continue
        P,cam,me=M[c['machine']]; P=app(P,c['P']); cam=app(cam,c['cam'])
        for j in(1,2):
            Q=dict(P)
            if c['push'] and j==1: Q.update(pushT=c['push'][0],pushD=c['push'][1],pushFx=c['push'][2],pushFy=c['push'][3])
            f=f'rec/{c["case"]}-{j}.mcap'
            if os.path.exists(f): continue
            s=record(f,Q,cam,1000+10*i+j,2000+10*i+j,c['speed'],f'{c["case"]}-{j}',me)
            print(c['case'],j,{k:(round(float(v),3) if not isinstance(v,tuple) else [round(float(z),3) for z in v]) for k,v in s.items()},flush=True)
